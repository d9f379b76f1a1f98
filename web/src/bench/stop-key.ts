// The key that stops the bench.

/** A key by its place on the keyboard and by what it is called. */
export interface StopKey {
  code: string;
  name: string;
}

export const SPACE: StopKey = { code: "Space", name: "Space" };

/** Keys that are needed for something else. */
const TAKEN = ["Tab", "Enter", "NumpadEnter", "Escape", "ContextMenu"];
const MODIFIER = /^(Shift|Control|Alt|Meta|OS|CapsLock|NumLock|ScrollLock|Fn)/;
/** Kinds of input that nobody types into. */
const NO_TEXT = ["button", "checkbox", "color", "file", "image", "radio", "range", "reset", "submit"];

type Pressed = Pick<KeyboardEvent, "code" | "key" | "altKey" | "ctrlKey" | "metaKey">;

/** Whether another key is held with it, which makes it a command of the browser's. */
export function isCombined(event: Pick<Pressed, "altKey" | "ctrlKey" | "metaKey">): boolean {
  return event.altKey || event.ctrlKey || event.metaKey;
}

/** The key pressed, if it may be the stop key. */
export function choosable(event: Pressed): StopKey | null {
  if (isCombined(event)) return null;
  if (event.code === "" || TAKEN.includes(event.code) || MODIFIER.test(event.code)) return null;
  return { code: event.code, name: event.key.trim() === "" ? event.code : event.key.toUpperCase() };
}

export interface Element {
  tagName: string;
  type?: string;
  inputMode?: string;
  readOnly?: boolean;
  isContentEditable?: boolean;
}

/** What has the focus. */
export function focusedElement(): Element | null {
  return document.activeElement instanceof HTMLElement ? (document.activeElement as HTMLInputElement) : null;
}

/** What a number is spelt with. */
const OF_NUMBERS = /^[\d.,+\-−eE]$/;

/** Whether a field takes numbers only. */
function isForNumbers({ type, inputMode }: Element): boolean {
  return type === "number" || inputMode === "decimal" || inputMode === "numeric";
}

/** Whether what has the focus takes text. */
export function isTyping(focused: Element | null): boolean {
  if (!focused) return false;
  if (focused.isContentEditable) return true;
  if (focused.tagName === "TEXTAREA") return true;
  return focused.tagName === "INPUT" && !NO_TEXT.includes(focused.type ?? "text");
}

/**
 * What a key event means: "stop" for the first press of the stop key, "consume" for its repeats and its release, which
 * would else click what has the focus; "pass" for everything else, and for what somebody types.
 */
export function meaning(
  event: Pressed & Pick<KeyboardEvent, "type" | "repeat" | "isComposing">,
  focused: Element | null,
  key: StopKey,
): "stop" | "consume" | "pass" {
  if (event.code !== key.code || event.isComposing || isCombined(event)) return "pass";
  // In a field for numbers what spells none stops, as it does everywhere: whoever moves an axis types there.
  const spelt = focused && isForNumbers(focused) ? OF_NUMBERS.test(event.key) : true;
  if (isTyping(focused) && spelt) return "pass";
  return event.type === "keydown" && !event.repeat ? "stop" : "consume";
}
