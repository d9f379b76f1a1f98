/** What an alignment will do, before it begins. */
export const plan = {
  impossible: "This camera cannot be aligned as it is configured:",
  obstacle: (value: string, needed: string, why: string) =>
    `is ${value}, and would have to be ${needed}: ${why}`,
  summary: (steps: number, seconds: number) =>
    `You are asked ${steps === 1 ? "once" : `${steps} times`}, again where a picture has to be repeated; it takes about ${Math.round(seconds)} s besides`,
  mounted: (e: string, spacing: string) => `The shell is mounted at e ${e}, where the spacing is ${spacing}.`,
  held: (e: string) => `e is held at ${e}, unless you name another; the plan is for that.`,
  above: (e: string, tolerance: string, more: string) =>
    `e is brought to ${e} ± ${tolerance}, or up to ${more} more where the wall does not let its axis go further.`,
  expected: (spacing: string, deltaV: string, e: string) =>
    `Expected to be good to ${spacing}, which is ${deltaV} of Δv and ${e} of e, by the picture and the axes alone:`,
  byBudget: (deltaV: string, e: string) =>
    `With all that is taken for granted Δv is good to ${deltaV} and e to ${e}.`,
  heldOff: (more: string) =>
    `e stays ${more} further from the shell than it is aimed at: three of these lie between the lens and where it touches.`,
};
