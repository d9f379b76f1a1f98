import { defineConfig } from "vitest/config";

declare const process: { env: Record<string, string | undefined> };

// The daemon that `npm run dev` shows: its Host and Origin checks see a page of its own.
const daemon = process.env["PLENALIGN"] ?? "http://127.0.0.1:8080";

export default defineConfig({
  oxc: { jsx: { runtime: "automatic", importSource: "preact" } },
  build: {
    target: "es2022",
    // The browser of the API's contract, which the page itself has no part of.
    chunkSizeWarningLimit: 2000,
    // What a file holds is in its name, by which a browser keeps it for good; the pages themselves are asked for each time.
    rollupOptions: {
      input: { index: "index.html", docs: "docs.html" },
      output: {
        entryFileNames: "assets/[name]-[hash].js",
        chunkFileNames: "assets/[name]-[hash].js",
        assetFileNames: "assets/[name]-[hash][extname]",
      },
    },
  },
  worker: {
    format: "es",
    rollupOptions: { output: { entryFileNames: "assets/[name]-[hash].js" } },
  },
  server: {
    // The glossary is the documentation's.
    fs: { allow: [".."] },
    proxy: {
      "/api": { target: daemon, changeOrigin: true, ws: true, headers: { origin: daemon } },
      "/healthz": daemon,
    },
  },
  test: { include: ["test/**/*.test.ts"], environment: "node", setupFiles: ["test/english.ts"] },
});
