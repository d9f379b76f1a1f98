import { describe, expect, it } from "vitest";
import { choosable, isTyping, meaning, SPACE } from "../src/bench/stop-key";

type Pressed = Parameters<typeof meaning>[0];
const key = (code: string, more: Partial<Pressed> = {}): Pressed => ({
  code,
  key: code === "Space" ? " " : code,
  type: "keydown",
  repeat: false,
  isComposing: false,
  altKey: false,
  ctrlKey: false,
  metaKey: false,
  ...more,
});
const button = { tagName: "BUTTON", type: "submit" };

describe("the stop key", () => {
  it("stops once, and is consumed for as long as it is held and when it is let go", () => {
    expect(meaning(key("Space"), button, SPACE)).toBe("stop");
    expect(meaning(key("Space", { repeat: true }), button, SPACE)).toBe("consume");
    expect(meaning(key("Space", { type: "keyup" }), button, SPACE)).toBe("consume");
    expect(meaning(key("Space"), null, SPACE)).toBe("stop");
  });

  it("is a character while somebody types, and stops on what takes no text", () => {
    const passes = [
      { tagName: "INPUT" },
      { tagName: "INPUT", type: "search" },
      { tagName: "TEXTAREA" },
      { tagName: "DIV", isContentEditable: true },
    ];
    for (const focused of passes) expect(meaning(key("Space"), focused, SPACE)).toBe("pass");
    for (const focused of [
      { tagName: "SELECT" },
      { tagName: "INPUT", type: "range" },
      { tagName: "SUMMARY" },
    ]) {
      expect(meaning(key("Space"), focused, SPACE)).toBe("stop");
    }
    expect(isTyping(null)).toBe(false);
  });

  it("stops in a field for numbers, too, unless it spells one", () => {
    const fields = [
      { tagName: "INPUT", type: "text", inputMode: "decimal" },
      { tagName: "INPUT", type: "number" },
    ];
    const five = { code: "Digit5", name: "5" };
    for (const field of fields) {
      expect(meaning(key("Space"), field, SPACE)).toBe("stop");
      expect(meaning(key("Space", { type: "keyup" }), field, SPACE)).toBe("consume");
      expect(meaning(key("Digit5", { key: "5" }), field, five)).toBe("pass");
    }
    expect(meaning(key("Digit5", { key: "5" }), button, five)).toBe("stop");
  });

  it("leaves every other key, and combinations, alone", () => {
    expect(meaning(key("Enter"), button, SPACE)).toBe("pass");
    expect(meaning(key("Space", { ctrlKey: true }), button, SPACE)).toBe("pass");
    expect(meaning(key("Space", { isComposing: true }), button, SPACE)).toBe("pass");
  });

  it("can be another one, and then the space bar is none", () => {
    const pause = choosable(key("Pause"));
    expect(pause).toEqual({ code: "Pause", name: "PAUSE" });
    expect(meaning(key("Pause"), null, pause ?? SPACE)).toBe("stop");
    expect(meaning(key("Space"), null, pause ?? SPACE)).toBe("pass");
    expect(choosable(key("KeyS", { key: "s" }))).toEqual({ code: "KeyS", name: "S" });
    expect(choosable(key("Space"))).toEqual(SPACE);
  });

  it("is none that moves the focus, presses a button, or modifies", () => {
    for (const code of [
      "Tab",
      "Enter",
      "NumpadEnter",
      "Escape",
      "ShiftLeft",
      "ControlRight",
      "AltLeft",
      "",
    ]) {
      expect(choosable(key(code))).toBeNull();
    }
    expect(choosable(key("KeyS", { metaKey: true }))).toBeNull();
  });
});
