// The page's words in the language it speaks.

export { strings } from "./strings/en";
