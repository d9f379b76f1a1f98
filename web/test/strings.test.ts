import ts from "typescript";
import { expect, it } from "vitest";

const views = import.meta.glob<string>("../src/views/**/*.{ts,tsx}", {
  query: "?raw",
  import: "default",
  eager: true,
});
/** Attributes whose text is read by people. */
const READ = ["title", "aria-label", "placeholder", "label", "alt", "question", "yes", "no"];
const WORDS = /\p{L}{2}/u;
/** A figure's unit, which the module of units spells. */
const UNIT = /^(°|\s?(mm|µm|px|ms|s|min|h)\b)/;

/** What a view says in its own words, with where it does. */
function spoken([file, text]: [string, string]): string[] {
  const source = ts.createSourceFile(file, text, ts.ScriptTarget.Latest, true, ts.ScriptKind.TSX);
  const found: string[] = [];
  const say = (node: ts.Node, text: string) => {
    const { line } = source.getLineAndCharacterOfPosition(node.getStart());
    found.push(`${file}:${line + 1} ${text.trim()}`);
  };
  const visit = (node: ts.Node): void => {
    if (ts.isJsxText(node) && WORDS.test(node.text)) say(node, node.text);
    if (ts.isJsxAttribute(node) && READ.includes(node.name.getText()) && node.initializer) {
      const value = node.initializer;
      if (ts.isStringLiteral(value) && WORDS.test(value.text)) say(value, value.text);
    }
    if (ts.isTemplateSpan(node) && UNIT.test(node.literal.text) && !/^px$/.test(node.literal.text)) {
      say(node, node.literal.text);
    }
    ts.forEachChild(node, visit);
  };
  visit(source);
  return found;
}

it("the page's words are in one place, and so is how units are spelt", () => {
  const files = Object.entries(views);
  expect(files.length).toBeGreaterThan(40);
  expect(files.flatMap(spoken)).toEqual([]);
});
