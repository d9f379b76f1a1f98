// The confirm key of a job: whoever starts one is given it and may hand it on, as a link, to whoever stands at the bench.
// It answers this job's prompts and nothing else. It is kept over a reload of the same tab, and for one job: a bench does
// one at a time.

import { addressOf } from "../browser/route";
import type { Bench } from "./wire";

const KEPT = "plenalign.confirm";
const KEY = /confirm_[0-9a-f]{64}/;

export interface ConfirmKey {
  /** The job's id. */
  job: string;
  key: string;
}

/** A link that opens the page at `page` with the key: behind the #, which no browser sends and no daemon logs. */
export function linkWith(page: string, { job, key }: ConfirmKey): string {
  return `${page}${addressOf("alignment", job, key)}`;
}

/** The key of a link that has opened the page, from the address behind the #. */
export function keyOfAddress(hash: string): ConfirmKey | null {
  const found = /^#\/alignment\/([0-9a-f-]{36})\/(confirm_[0-9a-f]{64})$/.exec(hash);
  return found?.[1] && found[2] ? { job: found[1], key: found[2] } : null;
}

/** Whether an address is such a link's and has been cut off or mistyped. */
export function isBrokenLink(hash: string): boolean {
  return /^#\/alignment\/[^/]*\/confirm_/.test(hash) && keyOfAddress(hash) === null;
}

/** The key in what somebody has typed or pasted: the key itself, or the link with it. */
export function keyWithin(text: string): string | null {
  return KEY.exec(text)?.[0] ?? null;
}

/** Whether a job's key confirms nothing any more, as another has been made since. */
export function isDead({ job, key }: ConfirmKey, bench: Bench | null): boolean {
  const begins = bench?.job === job ? bench.confirm_key_begins : null;
  return typeof begins === "string" && !key.startsWith(begins);
}

export class ConfirmKeys {
  constructor(private readonly storage: Pick<Storage, "getItem" | "setItem" | "removeItem">) {}

  /** The key of a job, where this tab has it. */
  of(job: string): string | null {
    const [of, key] = (this.storage.getItem(KEPT) ?? "").split(" ");
    return of === job && key !== undefined ? key : null;
  }

  keep({ job, key }: ConfirmKey): void {
    this.storage.setItem(KEPT, `${job} ${key}`);
  }

  forget(): void {
    this.storage.removeItem(KEPT);
  }
}
