import { afterEach, describe, expect, it } from "vitest";
import { moment } from "../src/words/format";
import { EXPLAINED, explain } from "../src/words/glossary";
import { numberOf } from "../src/words/number";
import { languageOf, localeOf, spoken } from "../src/words/language";
import * as page from "../src/strings";
import { speak } from "../src/strings";
import { strings as de } from "../src/strings/de";
import { strings as en } from "../src/strings/en";
import { length } from "../src/words/units";

const sources = import.meta.glob<string>("../src/strings/**/*.ts", {
  query: "?raw",
  import: "default",
  eager: true,
});
const jobs = import.meta.glob<string>("../../crates/control/src/alignment/*.rs", {
  query: "?raw",
  import: "default",
  eager: true,
});

it("one is not told like several", () => {
  for (const { plan, job } of [en, de]) {
    for (const one of [plan.summary(1, 40), job.watchMeans(1)]) expect(one).not.toMatch(/\b1\b/);
    for (const two of [plan.summary(2, 40), job.watchMeans(2)]) expect(two).toMatch(/\b2\b/);
  }
  expect(en.plan.summary(1, 40)).toBe(
    "You are asked once, again where a picture has to be repeated; it takes about 40 s besides",
  );
  expect(de.job.watchMeans(1)).toBe("Eine Messung");
});

type Said = string | ((...given: unknown[]) => unknown);

/** Every string of a catalogue, and every function that makes one, by its path. */
function said(catalogue: object, path = ""): Map<string, Said> {
  return new Map(
    Object.entries(catalogue).flatMap(([name, of]: [string, unknown]) => {
      const at = path === "" ? name : `${path}.${name}`;
      return typeof of === "object" && of !== null ? [...said(of, at)] : [[at, of as Said] as const];
    }),
  );
}

/** What is given to a function: a number, a text or a list, whatever it takes it for. */
function given(count: number): unknown[] {
  return Array.from({ length: count }, (_, index) => {
    const mark = String(7001 + index);
    const same = () => mark;
    return Object.assign([mark], { toFixed: same, replaceAll: same, toLowerCase: same });
  });
}

function sentence(of: Said): string {
  return typeof of === "string" ? of : String(of(...given(of.length)));
}

/** In English left to the daemon, and to the documentation's glossary. */
const ELSEWHERE = ["prompt", "explained"];
/** What is called the same, beside symbols, units and names. */
const ALIKE =
  /^(Plenalign|Live|STOP|Token|Link|Name|Zoom|Pixel|Sensor|hexagonal|Drift|Iteration|English|Deutsch|l_bound)$/;

describe("the German words", () => {
  const [english, german] = [said(en), said(de)];

  it("are there for each of the English, and no more", () => {
    expect([...german.keys()]).toEqual([...english.keys()]);
    expect(english.size).toBeGreaterThan(400);
  });

  it("say all that is given to the English ones", () => {
    const marks = (of: Said) => [...new Set(sentence(of).match(/70\d\d/g))].sort();
    for (const [path, of] of english) {
      const its = german.get(path) ?? "";
      expect([path, typeof its, its.length * Number(typeof its === "function")]).toEqual([
        path,
        typeof of,
        of.length * Number(typeof of === "function"),
      ]);
      if (!ELSEWHERE.includes(path)) expect([path, ...marks(its)]).toEqual([path, ...marks(of)]);
    }
  });

  it("are German, in German quotation marks", () => {
    const left = [...german].filter(([path, of]) => {
      if (ELSEWHERE.includes(path)) return false;
      const words = sentence(of);
      return words === sentence(english.get(path) ?? "") && /\p{L}{4}/u.test(words) && !ALIKE.test(words);
    });
    expect(left.map(([path, of]) => `${path}: ${sentence(of)}`)).toEqual([]);
    for (const [path, of] of german) {
      const marks = sentence(of).match(/[„“”"‘]/g) ?? [];
      expect([path, marks.join("")]).toEqual([path, "„“".repeat(marks.length / 2)]);
    }
  });

  it("explain each word of the field that the glossary explains in English", () => {
    for (const word of EXPLAINED) {
      const meaning = de.explained(word)?.meaning ?? "";
      expect([word, meaning.length > 20, meaning === explain(word)?.meaning]).toEqual([word, true, false]);
      expect(en.explained(word)).toBeNull();
    }
  });

  it("have each prompt that a job of the daemon has", () => {
    const asked = Object.values(jobs).flatMap((text) =>
      [...text.matchAll(/\.ask\(\s*"(\w+)"/g)].map(([, name]) => name ?? ""),
    );
    expect(new Set(asked).size).toBe(8);
    for (const name of asked) expect([name, de.prompt(name, "7 mm")]).not.toEqual([name, null]);
    expect(de.prompt("aperture", "6.36 mm, f/3.14")).toContain("6.36 mm, f/3.14");
    expect(de.prompt("another", "")).toBeNull();
  });
});

it("the words rest on nothing: what waits for them would have to wait for what waits for it", () => {
  const all = Object.entries(sources);
  expect(all.length).toBeGreaterThan(20);
  const needed = all.flatMap(([file, text]) =>
    [...text.matchAll(/^import (?!type\b).*?from "(.*?)"/gms)].map(([, from]) => [file, from ?? ""] as const),
  );
  expect(needed.filter(([, from]) => !from.startsWith("./"))).toEqual([]);
});

describe("the language", () => {
  it("is the one chosen, or the first of the browser's that the page has, or English", () => {
    expect(languageOf("browser", ["fr-CH", "de-CH", "en"])).toBe("de");
    expect(languageOf("browser", ["EN-us", "de"])).toBe("en");
    expect(languageOf("browser", ["fr", "den"])).toBe("en");
    expect(languageOf("browser", [])).toBe("en");
    expect(languageOf("en", ["de"])).toBe("en");
  });

  it("writes dates as the browser's region does, or else with the day first", () => {
    expect(localeOf("de", ["fr", "de-AT"])).toBe("de-AT");
    expect(localeOf("en", ["en-US"])).toBe("en-US");
    expect(localeOf("en", ["de-DE"])).toBe("en-GB");
    expect(localeOf("de", ["en"])).toBe("de-DE");
  });
});

describe("the page's words", () => {
  afterEach(() => speak("en"));

  it("change with the language, at once and for whoever has them already", async () => {
    expect(page.strings.stop.space).toBe("Space");
    await speak("de");
    expect([page.strings.stop.space, spoken.language]).toEqual(["Leertaste", "de"]);
    expect(moment("2026-03-05T10:20:30Z")).toMatch(/^0?5\.(03\.| März )2026/);
  });

  it("say a number with a decimal point in each language; where a comma may part thousands, such a one is none", async () => {
    expect([length(1.2345, "mm"), numberOf("1,234"), numberOf("1,23")]).toEqual(["1.234 mm", NaN, 1.23]);
    await speak("de");
    expect([length(1.2345, "mm"), numberOf("1,234"), numberOf("1.234")]).toEqual(["1.234 mm", 1.234, 1.234]);
  });
});
