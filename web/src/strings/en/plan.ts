/** What an alignment will do, before it begins. */
export const plan = {
  impossible: "This camera cannot be aligned as it is configured:",
  obstacle: (value: string, needed: string, why: string) =>
    `is ${value}, and would have to be ${needed}: ${why}`,
  summary: (steps: number, seconds: number) =>
    `You are asked ${steps} times; it takes about ${Math.round(seconds)} s besides`,
  steps: {
    white_frame: "Put the diffuser on",
    triple_board_in_air: "Triple-level board in air",
    board_in_air: "Flat board in air",
    aperture: "Set the aperture",
    shell_and_water: "Mount the shell, fill the tank, board in water",
  } as Record<string, string>,
  mounted: (e: string, spacing: string) => `The shell is mounted at e ${e}, where the spacing is ${spacing}.`,
  expected: (spacing: string, deltaV: string, e: string) =>
    `Expected to be good to ${spacing}, which is ${deltaV} of Δv and ${e} of e:`,
};
