import { useLayoutEffect, useRef } from "preact/hooks";
import { isFocusLost } from "../../browser/focus";
import * as api from "../../daemon/api";
import { secondsLeft } from "../../daemon/clock";
import { able, may } from "../../state";
import type { ControlLost } from "../../daemon/lease";
import { another, called } from "../../words/names";
import { strings } from "../../strings";
import { Ask } from "../ask";
import { useAsked } from "../asked";
import type { Given } from "../given";
import { useSettled } from "../settled";

/** Who may move the axes; how to become it, and how to cease to be. */
export function Lease({ state, act, now }: Given) {
  // A question is of the lease that there was: whoever takes control later is not asked about unasked.
  const [asked, ask] = useAsked<string>(able(state, "admin"));
  // Where control is taken it is given back, too.
  const settled = useSettled(state.bench?.lease?.id ?? "free");
  const { bench } = state;
  const lease = bench?.lease ?? null;
  const commanding = may(state, "control");
  // Whoever signed in since may do less than whoever took it here.
  const mine = commanding && lease !== null && api.lease.other(lease) === null;
  const asking = lease !== null && asked === lease.id;
  const left = lease?.expires_at ? secondsLeft(lease.expires_at, state.clock, now) : null;
  const words =
    state.link !== "open"
      ? strings.lease.unclear
      : lease === null
        ? strings.lease.free
        : mine
          ? strings.lease.mine(called(lease.owner))
          : strings.lease.held(another(lease.owner, "first"), lease.note);
  const more =
    lease === null || state.link !== "open"
      ? ""
      : lease.job
        ? strings.lease.byJob
        : mine || left === null
          ? ""
          : strings.lease.left(left);
  const holder = lease === null ? "free" : mine ? "mine" : "others";
  const box = useRef<HTMLDivElement>(null);
  // Once this is drawn, what had the focus is another button.
  const within = box.current?.contains(document.activeElement) ?? false;
  useLayoutEffect(() => {
    if (within && isFocusLost()) box.current?.querySelector("button")?.focus({ preventScroll: true });
  }, [holder]);
  if (!bench) return null;
  return (
    <div ref={box} class="lease" data-lease={state.link === "open" ? holder : "unclear"}>
      <p role="status">
        {more ? words.replace(/\.$/, "") : words} {more && <span class="quiet">{more}</span>}
      </p>
      {lease === null && commanding && state.link === "open" && (
        <button type="button" aria-disabled={!settled} onClick={() => settled && void act(api.takeLease())}>
          {strings.lease.take}
        </button>
      )}
      {mine && !lease.job && state.link === "open" && (
        <button
          type="button"
          aria-disabled={!settled}
          onClick={() => settled && void act(api.releaseLease())}
        >
          {strings.lease.release}
        </button>
      )}
      {lease !== null && !mine && able(state, "admin") && !asking && (
        <button type="button" onClick={() => ask(lease.id)}>
          {strings.lease.takeOver}
        </button>
      )}
      {lease !== null && !mine && asking && (
        <Ask
          question={strings.lease.takeOverSure(another(lease.owner), Boolean(lease.job))}
          yes={strings.lease.takeOverYes}
          no={strings.lease.takeOverNo}
          answer={(yes) => {
            ask(null);
            if (yes) void act(api.takeOverLease());
          }}
        />
      )}
    </div>
  );
}

/** That control was lost, told at once: what was held down has been let go of. */
export function ControlGone({ lost, update }: Given & { lost: ControlLost }) {
  return (
    <div class="control-lost" role="alert">
      <p>
        <b>{lost.to === null ? strings.lease.ranOut : strings.lease.taken(another(lost.to, "first"))}</b>{" "}
        {strings.lease.lostMore}
        {lost.to !== null && lost.job && ` ${strings.lease.lostJob}`}
      </p>
      <button type="button" onClick={() => update({ controlLost: null })}>
        {strings.dismiss}
      </button>
    </div>
  );
}
