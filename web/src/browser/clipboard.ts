// Copying: browsers give the clipboard to pages of HTTPS and of this machine only; elsewhere what is selected is copied.

/** Copies the text of an element; whether it could be done. The element is selected meanwhile, for whoever has to do it. */
export async function copy(from: HTMLElement): Promise<boolean> {
  getSelection()?.selectAllChildren(from);
  try {
    await navigator.clipboard.writeText(from.innerText);
    return true;
  } catch {
    return document.execCommand("copy");
  }
}
