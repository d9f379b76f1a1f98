// What a tab keeps for whoever is signed in in it: the keys of control and of a job's prompts. Who signs out while a job goes on
// finds them again; whoever else signs in here does not.

import type { Session } from "./wire";

const OF = "plenalign.of";

export class Belongings {
  constructor(
    private readonly storage: Pick<Storage, "getItem" | "setItem">,
    private readonly forget: () => void,
  ) {}

  /** Somebody is known to be here: what another has left is forgotten. Whether that was so. */
  cameIn({ name, signed_in }: Session): boolean {
    // Where nobody signs in, everybody is the same.
    if (!signed_in) return false;
    const before = this.storage.getItem(OF);
    const another = before !== null && before !== name;
    if (another) this.forget();
    this.storage.setItem(OF, name);
    return another;
  }
}
