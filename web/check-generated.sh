#!/bin/sh
# Compares what is generated from ../proto with what is committed in src/gen.
set -eu
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
buf generate --output "$scratch"
openapi-typescript ../proto/openapi.json -o "$scratch/src/gen/api.ts" >/dev/null
prettier --write --log-level warn --config .prettierrc.json "$scratch/src/gen"
diff -ru src/gen "$scratch/src/gen" || {
	echo "src/gen is not what ../proto says: run npm run generate" >&2
	exit 1
}
