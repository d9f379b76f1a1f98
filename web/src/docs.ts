// The API's contract, to be browsed and tried. It comes from the daemon, as everything here does.

import SwaggerUI from "swagger-ui-dist/swagger-ui-es-bundle.js";
import "swagger-ui-dist/swagger-ui.css";
import "./docs.css";

const CONTRACT = "/api/v1/openapi.json";

/** What its plugins are given. */
interface System {
  React: { createElement: (tag: string, props: null, child: unknown) => unknown };
}

/** Its style has a class for what the browser has a setting for. */
function followTheme(): void {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const follow = () => document.documentElement.classList.toggle("dark-mode", dark.matches);
  dark.addEventListener("change", follow);
  follow();
}

/** A link within a button is one of them too many: what it shows is opened by the button. */
const oneButton = ({ React }: System) => ({
  components: {
    DeepLink: ({ text }: { text: unknown }) => React.createElement("span", null, text),
  },
});

/** Names what has none, and lets keys scroll what scrolls, whenever something is opened. */
function mend(): void {
  for (const example of document.querySelectorAll<HTMLElement>("pre.microlight")) example.tabIndex = 0;
  for (const row of document.querySelectorAll("tr[data-param-name]")) {
    const name = row.getAttribute("data-param-name") ?? "";
    for (const field of row.querySelectorAll("select, input")) field.setAttribute("aria-label", name);
  }
  // Its title is of the first rank, and what follows of the third.
  for (const heading of document.querySelectorAll("#contract :is(h3, h4, h5, h6):not([aria-level])")) {
    heading.setAttribute("aria-level", String(Number(heading.tagName.slice(1)) - 1));
  }
  for (const field of document.querySelectorAll(".content-type, .body-param__text")) {
    if (!field.hasAttribute("aria-label")) field.setAttribute("aria-label", "body");
  }
  // Its title stands beside all landmarks.
  const title = document.querySelector("#contract .information-container");
  title?.setAttribute("role", "region");
  title?.setAttribute("aria-label", "About the contract");
}

async function main(): Promise<void> {
  const answer = await fetch(CONTRACT);
  if (answer.status === 401) {
    document.querySelector("#sign-in")?.removeAttribute("hidden");
    return;
  }
  if (!answer.ok) {
    const place = document.querySelector("#contract");
    if (place) place.textContent = `The contract cannot be read: ${answer.status} ${answer.statusText}.`;
    return;
  }
  SwaggerUI({
    dom_id: "#contract",
    spec: await answer.json(),
    deepLinking: true,
    docExpansion: "list",
    plugins: [oneButton],
    // Nothing is asked of a validator elsewhere, and no token is kept.
    validatorUrl: null,
    persistAuthorization: false,
  });
}

followTheme();
new MutationObserver(mend).observe(document.body, { childList: true, subtree: true });
void main();
