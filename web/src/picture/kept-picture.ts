// Pictures kept as files: what they are called, and how a browser is made to keep them.

/** What a picture's name says. */
export interface About {
  /** What it is: the picture as seen, or the frame as the camera gave it. */
  kind: "view" | "raw";
  capturedAt: Date;
  seq: number;
  simulated: boolean;
  replayed: boolean;
  preview: boolean;
}

/** In order of time where files are in order of names; in UTC, whatever the computer's clock is set to. */
export function nameOf({ kind, capturedAt, seq, simulated, replayed, preview }: About): string {
  const time = Number.isFinite(capturedAt.getTime())
    ? capturedAt.toISOString().replace(/[-:]/g, "")
    : "undated";
  const what = [simulated && "simulated", replayed && "replay", preview && "preview"].filter(Boolean);
  return ["plenalign", time, `frame-${seq}`, ...what, kind].join("-") + ".png";
}

/** Has the browser keep it. */
export function save(file: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(file);
  link.download = name;
  link.click();
  // The browser reads it meanwhile.
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
