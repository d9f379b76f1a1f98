import { useId, useLayoutEffect, useRef, useState } from "preact/hooks";
import { explain, pieces, type Word } from "../words/glossary";
import { spoken, type Language } from "../words/language";
import { strings } from "../strings";

/** A text with its words explained where they stand. */
export function Explained({ text }: { text: string }) {
  return (
    <>
      {pieces(text).map((piece, index) =>
        typeof piece === "string" ? piece : <Term key={`${piece.word} ${index}`} word={piece.word} />,
      )}
    </>
  );
}

/** Why its meaning is shown. */
interface Why {
  hovered: boolean;
  focused: boolean;
  /** Pressed, or tapped. */
  held: boolean;
}

const SHUT: Why = { hovered: false, focused: false, held: false };

/** A word and, while the pointer or the focus is on it or once it is tapped, what it means. No button, which would be left out
 *  on paper with all that can be pressed. */
function Term({ word }: { word: Word }) {
  const [why, set] = useState(SHUT);
  const id = useId();
  const around = useRef<HTMLSpanElement>(null);
  const glossary = explain(word);
  const translated = strings.explained(word);
  const open = why.hovered || why.focused || why.held;
  const shut = () => set(SHUT);
  const press = () => (why.held ? shut() : set({ ...why, held: true }));
  // Before it is seen: whoever sees it can shut it.
  useLayoutEffect(() => {
    if (!open) return undefined;
    const elsewhere = (event: Event) => around.current?.contains(event.target as Node) || shut();
    const escape = (event: KeyboardEvent) => event.key === "Escape" && shut();
    document.addEventListener("pointerdown", elsewhere);
    document.addEventListener("keydown", escape);
    return () => {
      document.removeEventListener("pointerdown", elsewhere);
      document.removeEventListener("keydown", escape);
    };
  }, [open]);
  if (!glossary) return <>{word}</>;
  return (
    <span
      ref={around}
      class="term"
      onPointerEnter={(event) => event.pointerType === "mouse" && set({ ...why, hovered: true })}
      onPointerLeave={(event) => event.pointerType === "mouse" && set({ ...why, hovered: false })}
    >
      <span
        class="word"
        role="button"
        tabIndex={0}
        aria-expanded={open}
        aria-describedby={open ? id : undefined}
        onFocus={(event) => event.currentTarget.matches(":focus-visible") && set({ ...why, focused: true })}
        onBlur={shut}
        onClick={press}
        onKeyDown={(event) => {
          if (event.key !== "Enter") return;
          event.preventDefault();
          press();
        }}
      >
        {word}
      </span>
      {open && <Meaning id={id} lang={translated ? spoken.language : "en"} {...glossary} {...translated} />}
    </span>
  );
}

interface MeaningProps {
  id: string;
  lang: Language;
  term: string;
  symbol: string;
  name: string;
  meaning: string;
}

/** From the edges of the screen at least, px. */
const EDGE = 8;

/** Whether two boxes have a part of the screen in common. */
function overlap({ left, top, width, height }: DOMRectReadOnly, other: DOMRect): boolean {
  return left < other.right && left + width > other.left && top < other.bottom && top + height > other.top;
}

/** Above everything, by the word; over STOP only where there is no other place, and a press goes through to it. */
function Meaning({ id, lang, term, symbol, name, meaning }: MeaningProps) {
  const box = useRef<HTMLSpanElement>(null);
  useLayoutEffect(() => {
    const element = box.current;
    const word = element?.previousElementSibling;
    if (!element || !word) return undefined;
    // In the top layer nothing cuts it off; a browser without one shows it in its place.
    element.showPopover?.();
    const place = () => {
      const at = word.getBoundingClientRect();
      const { width, height } = element.getBoundingClientRect();
      const left = Math.max(EDGE, Math.min(at.left, window.innerWidth - width - EDGE));
      const stop = document.getElementById("stop")?.getBoundingClientRect();
      const clear = (top: number) => !stop || !overlap(new DOMRectReadOnly(left, top, width, height), stop);
      const within = (top: number) => top >= EDGE && top + height + EDGE <= window.innerHeight;
      const above = Math.max(EDGE, at.top - height);
      const places = [at.bottom, above, (stop?.top ?? 0) - height, stop?.bottom ?? 0];
      const top = places.find((top) => within(top) && clear(top)) ?? above;
      element.style.left = `${left}px`;
      element.style.top = `${top}px`;
      element.style.pointerEvents = clear(top) ? "" : "none";
    };
    place();
    window.addEventListener("scroll", place, { capture: true, passive: true });
    window.addEventListener("resize", place);
    return () => {
      window.removeEventListener("scroll", place, { capture: true });
      window.removeEventListener("resize", place);
    };
  }, []);
  return (
    <span ref={box} id={id} class="meaning" role="tooltip" popover="manual" lang={lang}>
      <b>{symbol === term ? term : `${term} (${symbol})`}:</b> {meaning} {name && <code>{name}</code>}
    </span>
  );
}
