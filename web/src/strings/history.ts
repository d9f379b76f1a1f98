// Words of the history page.

export const history = {
  title: "History",
  search: "Search",
  searchMore: "words of its reason or log, or its id",
  kind: "Kind",
  state: "State",
  any: "any",
  since: "From",
  until: "Until",
  none: "No job fits.",
  more: "Show more",
  when: "When",
  what: "What",
  outcome: "Outcome",
  iterations: "Iterations",
  measure: "Reached",
  files: "Files",
  compare: "Compare",
  compareThis: (what: string) => `Compare ${what}`,
  compareMore: "Choose up to two jobs to see them on one chart.",
  compareTitle: (runs: number) =>
    runs < 2 ? "One run: choose another to compare it with" : "Two runs on one chart",
  clear: "Clear",
  difference: "spacing less target, px",
  missing: "Jobs of earlier runs are missing",
};
