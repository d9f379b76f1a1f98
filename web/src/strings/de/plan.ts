// Was eine Justage tun wird, bevor sie beginnt.

import type * as en from "../en/plan";

export const plan: typeof en.plan = {
  impossible: "Diese Kamera lässt sich so, wie sie konfiguriert ist, nicht justieren:",
  obstacle: (value, needed, why) => `ist ${value} und müsste ${needed} sein: ${why}`,
  summary: (steps, seconds) => `${steps} Handgriffe für Sie, dazu etwa ${Math.round(seconds)} s`,
  mounted: (e, spacing) => `Die Kugelschale wird bei e = ${e} montiert, wo der Punktabstand ${spacing} ist.`,
  expected: (spacing, deltaV, e) =>
    `Erwartete Unsicherheit: ${spacing}, das sind ${deltaV} bei Δv und ${e} bei e:`,
};
