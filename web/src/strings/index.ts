// Every word the page shows.

import { axis, byHand, lease, shell } from "./bench";
import { camera } from "./camera";
import { design } from "./design";
import { faults } from "./faults";
import { frame, signIn, stop } from "./frame";
import { history } from "./history";
import { form, iterations, job, outcome, report } from "./job";
import { charts, meter, picture } from "./live";
import { plan } from "./plan";
import { settings } from "./settings";
import { wayOn } from "./way-on";

export const strings = {
  ...frame,
  stop,
  signIn,
  picture,
  camera,
  meter,
  charts,
  lease,
  axis,
  byHand,
  shell,
  job,
  plan,
  form,
  iterations,
  report,
  outcome,
  wayOn,
  history,
  settings,
  faults,
  design,
};
