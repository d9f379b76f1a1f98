// The control lease as this page holds it. It is taken with the first command that needs it, renewed for as long as the
// page lives, and kept over a reload of the same tab.

import type { LeaseGrant, Problem } from "./wire";

const KEY = "plenalign.lease.key";
const ID = "plenalign.lease.id";
const HEARTBEAT_MS = 10_000;
/** Time to live: two missed heartbeats and it is free for another. */
const TTL_S = 30;

/** What a request of this module needs: a way to send one. */
export type Send = <T>(
  method: string,
  path: string,
  body?: unknown,
  key?: string,
) => Promise<{ ok: true; value: T } | { ok: false; problem: Problem }>;

/** How control ended that was not given back. */
export interface ControlLost {
  /** Who has it now; null where it ran out. */
  to: string | null;
  /** Whether a job went on with it, which was cancelled where another has taken it. */
  job: boolean;
}

export class LeaseKeeper {
  /** The lease that the daemon has said this page has, unless it was given back since. */
  private had: string | null = null;
  /** Whether a job went on with it. */
  private hadJob = false;
  /** The one that is being given back: that it is gone is no news. */
  private returning: string | null = null;
  /** Whether it is being asked for: the daemon may tell of it before it answers. */
  private asking = false;
  private timer: ReturnType<typeof setInterval> | null = null;
  /** By the clock that nobody sets, ms. */
  private renewedAt = 0;

  constructor(
    private readonly send: Send,
    private readonly owner: () => string,
    private readonly storage: Pick<Storage, "getItem" | "setItem" | "removeItem">,
  ) {
    if (this.key !== null) this.beat();
  }

  /** The key of the lease this page holds. */
  get key(): string | null {
    return this.storage.getItem(KEY);
  }

  /** The lease that this page holds. */
  get id(): string | null {
    return this.key === null ? null : this.storage.getItem(ID);
  }

  /** Whether a lease seen is the one this page holds. */
  isMine(lease: { id: string } | null): boolean {
    return lease !== null && lease.id === this.id;
  }

  /** Whether this page has it, and a job does with it. */
  hasJob(lease: { id: string; job?: string | null } | null, job: string): boolean {
    return lease?.job === job && this.isMine(lease);
  }

  /** Who else has control; null where this page has it, or nobody. */
  other(lease: { id: string; owner: string } | null | undefined): string | null {
    if (!lease || this.isMine(lease) || (this.asking && lease.owner === this.owner())) return null;
    return lease.owner;
  }

  /** Hears what the daemon says of the lease: that it is this page's, or that this page has lost it. */
  heard(lease: { id: string; owner: string; job?: string | null } | null): "mine" | ControlLost | null {
    const { had, hadJob } = this;
    this.had = lease && this.isMine(lease) && lease.id !== this.returning ? lease.id : null;
    this.hadJob = this.had !== null && Boolean(lease?.job);
    if (this.had !== null) return "mine";
    if (had === null) return null;
    const kept = this.storage.getItem(ID);
    // A refused command may have said first that it is lost, and not to whom.
    const refused = kept === null && lease !== null;
    // Another has been granted meanwhile, of which the daemon has not told yet.
    if (had !== kept && !refused) return null;
    this.forget();
    return { to: lease?.owner ?? null, job: hadJob };
  }

  /** Takes the lease where nobody has it. */
  take(): Promise<Problem | null> {
    return this.ask("/api/v1/lease");
  }

  /** Takes the lease from whoever has it; a job of theirs is cancelled, and an axis that moves is stopped. */
  takeOver(): Promise<Problem | null> {
    return this.ask("/api/v1/lease/takeover");
  }

  private async ask(path: string): Promise<Problem | null> {
    this.asking = true;
    const granted = await this.send<LeaseGrant>("POST", path, { owner: this.owner(), ttl_s: TTL_S });
    this.asking = false;
    if (!granted.ok) return granted.problem;
    this.storage.setItem(KEY, granted.value.key);
    this.storage.setItem(ID, granted.value.lease.id);
    this.beat();
    return null;
  }

  /** Sends a command that needs the lease, taking it first where it has to be. */
  async command<T>(
    method: string,
    path: string,
    body?: unknown,
  ): Promise<{ ok: true; value: T } | { ok: false; problem: Problem }> {
    const mine = this.key;
    if (mine !== null) {
      const answer = await this.send<T>(method, path, body, mine);
      if (answer.ok || answer.problem.status !== 412) return answer;
      this.forget();
    }
    const problem = await this.take();
    if (problem) return { ok: false, problem };
    return this.send<T>(method, path, body, this.key ?? undefined);
  }

  /**
   * Sends a command that goes on while it is repeated. The lease is taken with the first one where nobody has it, and
   * never anew: whoever took it over meanwhile is not to find the axis moving on.
   */
  async repeat<T>(
    method: string,
    path: string,
    body: unknown,
  ): Promise<{ ok: true; value: T } | { ok: false; problem: Problem }> {
    if (this.key === null) {
      const problem = await this.take();
      if (problem) return { ok: false, problem };
    }
    const mine = this.key;
    const answer = await this.send<T>(method, path, body, mine ?? undefined);
    if (!answer.ok && answer.problem.status === 412 && this.key === mine) this.forget();
    return answer;
  }

  /** Gives the lease back; it is kept where the daemon does not take it, or does not answer. */
  async release(): Promise<Problem | null> {
    const [mine, had] = [this.key, this.had];
    if (mine === null) return null;
    this.returning = this.storage.getItem(ID);
    this.had = null;
    const answer = await this.send("DELETE", "/api/v1/lease", undefined, mine);
    this.returning = null;
    if (this.key !== mine) return null;
    if (!answer.ok && answer.problem.status !== 412) {
      this.had = had;
      return answer.problem;
    }
    this.forget();
    return null;
  }

  /** Whoever had it has left: what becomes of it is not told to the next one. It is theirs again where they come back. */
  left(): void {
    this.had = null;
  }

  /** Nothing of it is left here; the daemon has it run out, or end with its job. */
  abandon(): void {
    this.left();
    this.forget();
  }

  /**
   * Renews the lease when that is due. The page's own timer is not enough: browsers slow the timers of a hidden tab down
   * to one a minute, but not those of a worker, whose signs of life call this.
   */
  due(): void {
    if (this.key !== null && performance.now() - this.renewedAt >= HEARTBEAT_MS) void this.renew();
  }

  private beat(): void {
    this.renewedAt = performance.now();
    this.timer ??= setInterval(() => this.due(), HEARTBEAT_MS);
  }

  private async renew(): Promise<void> {
    const mine = this.key;
    if (mine === null) return;
    this.renewedAt = performance.now();
    const answer = await this.send("POST", "/api/v1/lease/heartbeat", undefined, mine);
    // Lost to another, or run out while the tab slept: the next command takes it anew, or says who has it.
    if (!answer.ok && answer.problem.status === 412 && this.key === mine) this.forget();
  }

  private forget(): void {
    this.storage.removeItem(KEY);
    this.storage.removeItem(ID);
    if (this.timer !== null) clearInterval(this.timer);
    this.timer = null;
  }
}
