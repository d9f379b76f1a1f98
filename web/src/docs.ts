// The API's contract, to be browsed and tried. It comes from the daemon, as everything here does.

import SwaggerUI from "swagger-ui-dist/swagger-ui-es-bundle.js";
import "swagger-ui-dist/swagger-ui.css";
import "./docs.css";

const CONTRACT = "/api/v1/openapi.json";

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
    // Nothing is asked of a validator elsewhere, and no token is kept.
    validatorUrl: null,
    persistAuthorization: false,
  });
}

void main();
