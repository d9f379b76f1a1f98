// What is used of a library that says nothing of its types.
declare module "swagger-ui-dist/swagger-ui-es-bundle.js" {
  export default function SwaggerUI(options: {
    dom_id: string;
    spec: unknown;
    deepLinking: boolean;
    plugins: unknown[];
    docExpansion: "list" | "full" | "none";
    validatorUrl: null;
    persistAuthorization: boolean;
  }): unknown;
}
