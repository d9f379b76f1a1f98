/** What is offered after a job that ended early. */
export const wayOn = {
  title: "To go on",
  airStep: {
    holds: "The air step still holds: the shell step can go on from it.",
    doubtful:
      "The air step still holds if its boards stood where they were asked for. If shell, water and board are right, begin again in air.",
    gone: "No air step holds: Δv has to be set in air first.",
  },
  look: "Look at the bench: the axes stand wherever they were, and nothing goes on by itself.",
  shell:
    "Whether the shell is on is not known any more, and counts as on: say so on the page Live, under “Shell”.",
  resetFirst: "The bench is stopped: reset the stop first.",
  goOn: (kind: string) => `Go on: ${kind}`,
  again: (kind: string) => `Begin again: ${kind}`,
};
