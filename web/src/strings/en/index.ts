// Every word the page shows, in English.

import { axis, byHand, lease, shell } from "./bench";
import { camera } from "./camera";
import { design } from "./design";
import { explained } from "./explained";
import { faults } from "./faults";
import { frame, signIn, stop } from "./frame";
import { history } from "./history";
import { install } from "./install";
import { form, iterations, job, outcome, report } from "./job";
import { charts, meter, picture } from "./live";
import { measuring } from "./measuring";
import { meterPage } from "./meter-page";
import { plan } from "./plan";
import { prompt } from "./prompts";
import { settings } from "./settings";
import { setUp, steps } from "./steps";
import { throughFocus } from "./through-focus";
import { wayOn } from "./way-on";

export const strings = {
  ...frame,
  stop,
  signIn,
  picture,
  camera,
  meter,
  meterPage,
  measuring,
  charts,
  lease,
  axis,
  byHand,
  shell,
  job,
  plan,
  prompt,
  explained,
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
  install,
  faults,
  design,
};
