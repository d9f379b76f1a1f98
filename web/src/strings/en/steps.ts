// Words of a job's steps: what is set up, in which order, and how long it takes.

import type { Setup, StepState } from "../../daemon/wire";

const names: Record<string, string> = {
  homing: "Homing",
  preparation: "Devices, and homing where it is needed",
  measuring: "Measuring",
  white_frame: "Put the diffuser on",
  triple_board_in_air: "Triple-level board in air",
  board_in_air: "Flat board in air",
  aperture: "Set the aperture",
  least_e_by_hand: "Mount the shell, fill the tank, push the camera to the shell by hand",
  shell_off: "Take the shell off and the tank away",
  shell_and_water: "Mount the shell, fill the tank, board in water",
  board_in_water: "Board in water",
};

export const steps = {
  title: "Steps",
  summary: (count: number) => `Steps, and how long each took: ${count}`,
  name: (name: string) => names[name] ?? name.replaceAll("_", " "),
  state: {
    done: "done",
    now: "now",
    next: "next",
    repeated: "asked for again below: counts no more",
  } satisfies Record<StepState, string>,
  /** Of a job that has ended. */
  ended: { now: "not finished", next: "not reached" },
  you: (text: string) => `operator ${text}`,
  bench: (text: string) => `bench ${text}`,
  repeats: (number: number) => `step ${number} once more`,
  numbered: (number: number) => `no. ${number}`,
  again: "Do it again…",
  againWhat: (name: string) => `Do it again…: ${name}`,
  againSure: {
    white_frame:
      "Take the white frame again? What was measured by it in air is measured anew; the job goes on from there.",
    other:
      "Put the board up again? Air is measured anew from there; the white frame, and an aperture that has been set, stay.",
  },
  againYes: "Do it again",
  againNo: "Leave it",
};

/** What a drawing shows, for who cannot see it, and the words in it. */
export const setUp = {
  diffuser: "diffuser",
  water: "water",
  drawing: {
    diffuser: () => "A diffuser on the lens, lit evenly from in front",
    boards_in_air: (at: string, levels: number) =>
      levels > 1
        ? `In air, the levels of the board ${at} from the lens’s principal point`
        : `In air, a flat board ${at} from the lens’s principal point`,
    aperture: (diameter: string, ring: string) => `The aperture open by ${diameter}, f/${ring} on the ring`,
    board_in_water: (at: string) =>
      `The shell on the camera, the tank full, a flat board ${at} from the shell’s outer vertex`,
    least_e: (at: string) =>
      `The shell on, the tank full, a flat board ${at} from the shell’s outer vertex; the camera is pushed to the shell by hand`,
    shell_off: () => "The shell taken off, the tank away",
  } satisfies Record<Setup["type"], (...words: never[]) => string>,
  ring: (number: string) => `f/${number}`,
};
