// Every word the page shows.

import { axis, byHand, lease, shell } from "./bench";
import { design } from "./design";
import { faults } from "./faults";
import { frame, signIn, stop } from "./frame";
import { history } from "./history";
import { form, iterations, job, outcome, report } from "./job";
import { charts, meter, picture } from "./live";
import { plan } from "./plan";
import { settings } from "./settings";
import { setUp, steps } from "./steps";
import { throughFocus } from "./through-focus";
import { wayOn } from "./way-on";

export const strings = {
  ...frame,
  stop,
  signIn,
  picture,
  meter,
  charts,
  lease,
  axis,
  byHand,
  shell,
  job,
  plan,
  steps,
  setUp,
  form,
  iterations,
  report,
  outcome,
  wayOn,
  throughFocus,
  history,
  settings,
  faults,
  design,
};
