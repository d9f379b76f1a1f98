import { expect, it } from "vitest";
import index from "../index.html?raw";
import text from "../public/manifest.webmanifest?raw";

interface Icon {
  src: string;
  sizes: string;
  type: string;
  purpose?: string;
}

const manifest = JSON.parse(text) as Record<string, unknown> & { icons: Icon[] };

it("the page has what browsers want before they install it", () => {
  expect(manifest).toMatchObject({ name: "Plenalign", start_url: "/", scope: "/", display: "standalone" });
  const pngs = manifest.icons.filter(({ type }) => type === "image/png");
  for (const sizes of ["192x192", "512x512"])
    expect(
      pngs.some((icon) => icon.sizes === sizes && icon.purpose === undefined),
      sizes,
    ).toBe(true);
  expect(manifest.icons.some(({ purpose }) => purpose === "maskable")).toBe(true);
  expect(index).toContain('rel="manifest" href="/manifest.webmanifest"');
});

it("nothing answers in the daemon's place: there is no service worker", () => {
  const sources = import.meta.glob<string>("../src/**/*.{ts,tsx}", {
    query: "?raw",
    import: "default",
    eager: true,
  });
  const all = Object.entries(sources);
  expect(all.length).toBeGreaterThan(100);
  expect(all.filter(([, text]) => /serviceWorker|caches\.open/.test(text)).map(([file]) => file)).toEqual([]);
});
