// What the tests of the page's words expect, whatever the machine's language.

import { vi } from "vitest";

vi.stubGlobal("navigator", { languages: ["en-GB"] });
