import { useEffect, useRef } from "preact/hooks";
import { painter } from "../../painter";

type Probe = ReturnType<typeof painter.probe>;

const ZOOM = 1.25;
const PAN_PX = 60;

/** Wheel, drag, pinch and keys on the picture. */
export function useGestures(setProbe: (probe: Probe) => void) {
  const fingers = useRef(new Map<number, { x: number; y: number }>());
  const element = useRef<HTMLElement | null>(null);

  // Not passive, as a listener of the framework's would be: the page is not to scroll meanwhile.
  useEffect(() => {
    const canvas = document.getElementById("live");
    element.current = canvas;
    const wheel = (event: WheelEvent) => {
      event.preventDefault();
      painter.zoom(Math.exp(-event.deltaY / 400), { x: event.offsetX, y: event.offsetY });
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
    setProbe(painter.probe(at));
    if (!before) return;
    const was = spread();
    fingers.current.set(event.pointerId, at);
    const is = spread();
    if (was !== null && is !== null && was > 0) {
      const places = [...fingers.current.values()];
      const middle = {
        x: places.reduce((sum, place) => sum + place.x, 0) / places.length,
        y: places.reduce((sum, place) => sum + place.y, 0) / places.length,
      };
      painter.zoom(is / was, middle);
    } else {
      painter.pan(at.x - before.x, at.y - before.y);
    }
  };

  const lift = (event: PointerEvent) => {
    fingers.current.delete(event.pointerId);
    if (event.pointerType !== "mouse") setProbe(null);
  };

  const onKeyDown = (event: KeyboardEvent) => {
    const keys: Record<string, () => void> = {
      "+": () => painter.zoom(ZOOM),
      "=": () => painter.zoom(ZOOM),
      "-": () => painter.zoom(1 / ZOOM),
      "0": () => painter.all(),
      ArrowLeft: () => painter.pan(PAN_PX, 0),
      ArrowRight: () => painter.pan(-PAN_PX, 0),
      ArrowUp: () => painter.pan(0, PAN_PX),
      ArrowDown: () => painter.pan(0, -PAN_PX),
    };
    const act = keys[event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    act();
  };

  return {
    onPointerDown: (event: PointerEvent) => {
      fingers.current.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
      element.current?.setPointerCapture(event.pointerId);
    },
    onPointerMove,
    onPointerUp: lift,
    onPointerCancel: lift,
    onPointerLeave: (event: PointerEvent) => {
      lift(event);
      setProbe(null);
    },
    onDblClick: () => painter.all(),
    onKeyDown,
  };
}
