import { useEffect, useRef } from "preact/hooks";
import { isCombined } from "../../bench/stop-key";
import { moved, stretchOf, zoomed, type Looked, type Stretch } from "../../charts/stretch";

/** One turn, one press. */
const STEP = 1.5;
/** Of what is seen. */
const SHARE = 0.25;
/** A page that is being scrolled goes on being scrolled over a chart, until the pointer is moved, ms. */
const SCROLLING_MS = 400;

export interface Handles {
  zoom: (factor: number, about?: number) => void;
  move: (share: number) => void;
}

/** Wheel, drag, pinch and keys on charts that show one stretch of time. */
export function useChartGestures(looked: Looked, all: Stretch, look: (looked: Looked) => void) {
  const row = useRef<HTMLDivElement>(null);
  const fingers = useRef(new Map<number, number>());
  const scrolledAt = useRef(-Infinity);
  const seen = stretchOf(looked, all);
  const handles: Handles = {
    zoom: (factor, about = (seen.from + seen.to) / 2) => look(zoomed(seen, factor, about, all)),
    move: (share) => look(moved(seen, share * (seen.to - seen.from), all)),
  };

  /** The time under a place of the screen, and seconds to a pixel. */
  const timeAt = (event: MouseEvent) => {
    const over = (event.target as Element | null)?.closest?.(".chart")?.querySelector(".u-over");
    const box = over?.getBoundingClientRect();
    if (!box || box.width === 0) return null;
    const scale = (seen.to - seen.from) / box.width;
    return { at: seen.from + (event.clientX - box.left) * scale, scale, left: box.left };
  };

  const wheel = (event: WheelEvent) => {
    const there = timeAt(event);
    const scrolling = performance.now() - scrolledAt.current < SCROLLING_MS;
    if (!there || (scrolling && !event.ctrlKey)) return;
    // Where there is no more to be seen the page is scrolled.
    if (event.deltaY > 0 && seen.from <= all.from && seen.to >= all.to) return;
    event.preventDefault();
    handles.zoom(Math.exp(event.deltaY / 400), there.at);
  };
  const newest = useRef(wheel);
  newest.current = wheel;
  // Not passive, as a listener of the framework's would be.
  useEffect(() => {
    const element = row.current;
    const hear = (event: WheelEvent) => newest.current(event);
    const scrolled = () => (scrolledAt.current = performance.now());
    element?.addEventListener("wheel", hear, { passive: false });
    window.addEventListener("scroll", scrolled, { passive: true });
    return () => {
      element?.removeEventListener("wheel", hear);
      window.removeEventListener("scroll", scrolled);
    };
  }, []);

  const onPointerMove = (event: PointerEvent) => {
    // One that stands still while the page goes by is said to move, too, by nothing.
    if (event.movementX !== 0 || event.movementY !== 0) scrolledAt.current = -Infinity;
    const before = fingers.current.get(event.pointerId);
    const there = before === undefined ? null : timeAt(event);
    if (before === undefined || !there) return;
    const other = [...fingers.current].find(([id]) => id !== event.pointerId)?.[1];
    fingers.current.set(event.pointerId, event.clientX);
    if (other === undefined) return look(moved(seen, (before - event.clientX) * there.scale, all));
    const [was, is] = [Math.abs(before - other), Math.abs(event.clientX - other)];
    const middle = seen.from + ((event.clientX + other) / 2 - there.left) * there.scale;
    if (was > 0 && is > 0) handles.zoom(was / is, middle);
  };
  const lift = (event: PointerEvent) => void fingers.current.delete(event.pointerId);

  const onKeyDown = (event: KeyboardEvent) => {
    const keys: Record<string, () => void> = {
      "+": () => handles.zoom(1 / STEP),
      "=": () => handles.zoom(1 / STEP),
      "-": () => handles.zoom(STEP),
      "0": () => look("recent"),
      ArrowLeft: () => handles.move(-SHARE),
      ArrowRight: () => handles.move(SHARE),
    };
    const act = keys[event.key];
    if (!act || isCombined(event)) return;
    event.preventDefault();
    act();
  };

  const on = {
    onPointerDown: (event: PointerEvent) => {
      if (event.button !== 0 || !timeAt(event)) return;
      fingers.current.set(event.pointerId, event.clientX);
      (event.target as Element).setPointerCapture(event.pointerId);
    },
    onPointerMove,
    onPointerUp: lift,
    onPointerCancel: lift,
    onDblClick: () => look("recent"),
    onKeyDown,
  };
  return { row, on, handles, step: STEP, share: SHARE };
}
