// What a job asks its operator, by the prompt's name.

/** What is asked, said by the page; null where it is left to the daemon, which speaks English itself. */
export function prompt(_name: string, _value: string): string | null {
  return null;
}
