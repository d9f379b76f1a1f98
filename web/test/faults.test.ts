import { afterEach, describe, expect, it, vi } from "vitest";

describe("a change of what goes wrong", () => {
  afterEach(() => vi.unstubAllGlobals());

  it("brings nothing back that others have made good since, and loses none of two at once", async () => {
    const RIGHT = { camera: { unplugged: false, frozen: false }, disk: { full: false, delay_ms: 0 } };
    let now = { camera: { unplugged: true, frozen: false }, disk: { full: false, delay_ms: 0 } };
    const fetch = async (_: string, { method, body }: { method: string; body?: string }) => {
      await Promise.resolve();
      if (method === "PUT") now = { ...RIGHT, ...(JSON.parse(body!) as Partial<typeof now>) };
      return new Response(JSON.stringify(now));
    };
    vi.stubGlobal("fetch", fetch);
    vi.stubGlobal("sessionStorage", { getItem: () => null });
    const api = await import("../src/daemon/api");
    const all = [
      api.changeFaults({ disk: { delay_ms: 9 } }),
      api.clearFaults(),
      api.changeFaults({ camera: { frozen: true } }),
      api.changeFaults({ disk: { full: true } }),
      api.faults(),
    ];
    const then = { camera: { unplugged: false, frozen: true }, disk: { full: true, delay_ms: 0 } };
    expect((await Promise.all(all)).at(-1)).toEqual({ ok: true, value: then });
    // Made good by others, of which this page has not heard.
    now = { ...then, disk: { full: false, delay_ms: 0 } };
    await api.changeFaults({ camera: { unplugged: true } });
    expect(now).toEqual({ ...now, camera: { unplugged: true, frozen: true } });
    expect(now.disk.full).toBe(false);
  });
});
