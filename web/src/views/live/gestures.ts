import { useEffect, useRef } from "preact/hooks";
import { eyepiece, type Probe } from "../../picture/eyepiece";
import type { Place } from "../../picture/marks";
import { isCombined } from "../../bench/stop-key";

const ZOOM = 1.25;
const PAN_PX = 60;
/** What is marked goes by less: it is placed, not looked for. */
const SHIFT_PX = 6;

/** Wheel, drag, pinch and keys on the picture. */
export function useGestures(setProbe: (probe: Probe | null) => void) {
  const fingers = useRef(new Map<number, { x: number; y: number }>());
  const element = useRef<HTMLElement | null>(null);
  const { marking } = eyepiece;
  /** The pixel where what is being drawn begins. */
  const begun = useRef<Place | null>(null);

  // Not passive, as a listener of the framework's would be: the page is not to scroll meanwhile.
  useEffect(() => {
    const canvas = document.getElementById("live");
    element.current = canvas;
    const wheel = (event: WheelEvent) => {
      event.preventDefault();
      eyepiece.zoom(Math.exp(-event.deltaY / 400), { x: event.offsetX, y: event.offsetY });
    };
    canvas?.addEventListener("wheel", wheel, { passive: false });
    return () => canvas?.removeEventListener("wheel", wheel);
  }, []);

  const spread = () => {
    const [one, other] = [...fingers.current.values()];
    return one && other ? Math.hypot(one.x - other.x, one.y - other.y) : null;
  };

  const onPointerMove = (event: PointerEvent) => {
    const before = fingers.current.get(event.pointerId);
    const at = { x: event.offsetX, y: event.offsetY };
    void eyepiece.probe(at, setProbe);
    if (!before) return;
    if (begun.current && fingers.current.size === 1) {
      const pixel = marking.pixel(at);
      if (pixel) marking.draw(begun.current, pixel);
      return;
    }
    const was = spread();
    fingers.current.set(event.pointerId, at);
    const is = spread();
    if (was !== null && is !== null && was > 0) {
      const places = [...fingers.current.values()];
      const middle = {
        x: places.reduce((sum, place) => sum + place.x, 0) / places.length,
        y: places.reduce((sum, place) => sum + place.y, 0) / places.length,
      };
      eyepiece.zoom(is / was, middle);
    } else {
      eyepiece.pan(at.x - before.x, at.y - before.y);
    }
  };

  const lift = (event: PointerEvent) => {
    fingers.current.delete(event.pointerId);
    begun.current = null;
    if (event.pointerType !== "mouse") setProbe(null);
  };

  const onKeyDown = (event: KeyboardEvent) => {
    const toMark: Record<string, [number, number]> = {
      ArrowLeft: [-SHIFT_PX, 0],
      ArrowRight: [SHIFT_PX, 0],
      ArrowUp: [0, -SHIFT_PX],
      ArrowDown: [0, SHIFT_PX],
    };
    const shift = marking.tool === null ? undefined : toMark[event.key];
    if (shift && !isCombined(event)) {
      event.preventDefault();
      return marking.shift(...shift, event.shiftKey);
    }
    if (event.key === "Escape" && marking.tool !== null) return marking.use(null);
    const keys: Record<string, () => void> = {
      "+": () => eyepiece.zoom(ZOOM),
      "=": () => eyepiece.zoom(ZOOM),
      "-": () => eyepiece.zoom(1 / ZOOM),
      "0": () => eyepiece.all(),
      ArrowLeft: () => eyepiece.pan(PAN_PX, 0),
      ArrowRight: () => eyepiece.pan(-PAN_PX, 0),
      ArrowUp: () => eyepiece.pan(0, PAN_PX),
      ArrowDown: () => eyepiece.pan(0, -PAN_PX),
    };
    const act = keys[event.key];
    if (!act || isCombined(event)) return;
    event.preventDefault();
    act();
  };

  return {
    onPointerDown: (event: PointerEvent) => {
      fingers.current.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
      element.current?.setPointerCapture(event.pointerId);
      // A second finger zooms.
      const alone = marking.tool !== null && fingers.current.size === 1;
      begun.current = alone ? marking.pixel({ x: event.offsetX, y: event.offsetY }) : null;
    },
    onPointerMove,
    onPointerUp: lift,
    onPointerCancel: lift,
    onPointerLeave: (event: PointerEvent) => {
      lift(event);
      setProbe(null);
    },
    onDblClick: () => marking.tool === null && eyepiece.all(),
    onKeyDown,
  };
}
