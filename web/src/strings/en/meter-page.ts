// Words of the meter by itself, for a second screen or a phone.

export const meterPage = {
  open: "By itself",
  openMore: "The meter alone, in large figures: for a second screen, or a phone",
  back: "◀ Whole page",
  unit: "px",
  fullScreen: "Full screen",
  spacing: (spacing: string, sigma: string, target: string) =>
    `${spacing} ± ${sigma} px, target ${target} px`,
  age: (seconds: string) => `${seconds} s old`,
};
