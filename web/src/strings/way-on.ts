/** What is offered after a job that ended early. */
export const wayOn = {
  title: "To go on",
  airStep: {
    holds: "The air step still holds: the shell step can go on from it.",
    gone: "No air step holds: Δv has to be set in air first.",
  },
  resetFirst: "The bench is stopped: reset the stop first.",
  goOn: (kind: string) => `Go on: ${kind}`,
  again: (kind: string) => `Begin again: ${kind}`,
};
