// Packs every file of the built page once, rather than at each request: the daemon sends the `.gz` beside a file.

import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { constants, gzipSync } from "node:zlib";

for (const folder of ["dist", "dist/assets"]) {
  for (const name of readdirSync(folder).filter((name) => /\.(js|css|html|svg|webmanifest)$/.test(name))) {
    const path = join(folder, name);
    writeFileSync(`${path}.gz`, gzipSync(readFileSync(path), { level: constants.Z_BEST_COMPRESSION }));
  }
}
