// Control is kept with the tab, and a tab that is opened from another, or duplicated, begins with a copy of what that keeps.
// Two tabs are not to command by one lease: a button let go of in one would not be in the other.

const CHANNEL = "plenalign.lease";

/** A page asks whether an older one has the same lease, and that one says so. */
type Word = { asks: string; since: number } | { has: string };

/** What has the lease of a page. */
interface Holder {
  /** Of the lease that this page holds. */
  readonly id: string | null;
  /** Forgets it here; whoever has it keeps it. */
  abandon(): void;
}

/** Has the lease stay with the page that had it first; `since` is when this page began, ms. */
export function keepToOne(holder: Holder, since: number, channel = new BroadcastChannel(CHANNEL)): void {
  const asked = holder.id;
  const say = (word: Word) => channel.postMessage(word);
  channel.onmessage = ({ data }: MessageEvent<Word>) => {
    if ("asks" in data) {
      if (data.asks === holder.id && since < data.since) say({ has: data.asks });
    } else if (data.has === asked && holder.id === asked) {
      holder.abandon();
    }
  };
  if (asked !== null) say({ asks: asked, since });
}
