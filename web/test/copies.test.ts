import { expect, test, vi } from "vitest";
import { keepToOne } from "../src/daemon/copies";

function page(id: string | null, since: number) {
  const channel = new BroadcastChannel("a test's");
  const holder = { id, abandon: () => (holder.id = null) };
  keepToOne(holder, since, channel);
  return { holder, close: () => channel.close() };
}

test("a copy of a tab leaves the lease to the tab that had it first", async () => {
  const first = page("one", 1);
  const stranger = page("two", 1);
  const copy = page("one", 2);
  const another = page("two", 3);
  await vi.waitFor(() => expect([copy.holder.id, another.holder.id]).toEqual([null, null]));
  expect([first.holder.id, stranger.holder.id]).toEqual(["one", "two"]);
  // One that begins with none takes its own later.
  const later = page(null, 4);
  later.holder.id = "three";
  const itsCopy = page("three", 5);
  await vi.waitFor(() => expect(itsCopy.holder.id).toBeNull());
  expect(later.holder.id).toBe("three");
  for (const each of [first, stranger, copy, another, later, itsCopy]) each.close();
});
