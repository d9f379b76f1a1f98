import { describe, expect, it } from "vitest";
import { entriesOf, EXPLAINED, explain, pieces } from "../src/words/glossary";
import { strings } from "../src/strings";

describe("the words of the field", () => {
  it("are each in the documentation's glossary, under the symbol that the page shows", () => {
    for (const word of EXPLAINED) {
      const entry = explain(word);
      expect(entry, word).not.toBeNull();
      expect(entry?.meaning.length, word).toBeGreaterThan(20);
      expect(entry?.meaning).not.toMatch(/[`|]/);
    }
    expect(explain("EOG")?.term).toBe("energy of gradient");
    expect(explain("l_bound")?.name).toBe("assembly.l_bound_mm");
    expect(explain("nowhere")).toBeNull();
  });

  it("are each on the page", () => {
    const said = JSON.stringify(strings, (_key, value: unknown) =>
      typeof value === "function" ? String(value) : value,
    );
    for (const word of EXPLAINED) {
      expect(
        pieces(said.replaceAll('"', " ")).some((piece) => typeof piece === "object" && piece.word === word),
        word,
      ).toBe(true);
    }
  });

  it("are found where they stand by themselves, each once in a text", () => {
    const words = (text: string) =>
      pieces(text)
        .filter((piece) => typeof piece === "object")
        .map(({ word }) => word);
    expect(words("Δv is moved for the e held: Δv 1.2 mm at e 0.")).toEqual(["Δv", "e"]);
    expect(words("Move MLA and sensor 0.1 mm")).toEqual(["MLA"]);
    expect(words("e axis, mm")).toEqual(["e"]);
    expect(words("Least e (l_bound)")).toEqual(["e", "l_bound"]);
    for (const text of ["Pitch D_MLA", "the lens’s e-mail", "every", "1e-3", "EOGs"])
      expect(words(text), text).toEqual([]);
    const text = "or Δv by +0.1 mm, e, and Δv";
    expect(
      pieces(text)
        .map((piece) => (typeof piece === "string" ? piece : piece.word))
        .join(""),
    ).toBe(text);
  });

  it("come from tables of four columns alone", () => {
    expect(
      entriesOf(
        "| term | symbol | name, unit | meaning |\n|---|---|---|---|\n| a | A | `x_mm` | what it is |\n| b | c |",
      ),
    ).toEqual([{ term: "a", symbol: "A", name: "x_mm", meaning: "what it is" }]);
  });
});
