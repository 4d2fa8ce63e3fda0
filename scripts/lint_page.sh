#!/usr/bin/env bash
# Checks the types in the scripts of `tdcr view`'s page (JSDoc, read by TypeScript). Where there is no node, or no network to fetch
# TypeScript from, this says so and passes: the page needs neither.
set -u
cd "$(dirname "$0")/.."

if ! command -v npm >/dev/null 2>&1; then
    echo "lint-page: no npm here; the types in src/view/page were not checked"
    exit 0
fi
folder=target/page
mkdir -p "$folder/three"
cp src/view/page/*.js src/view/page/jsconfig.json "$folder/"
# The types of three.js stand for its code.
echo 'export { OrbitControls } from "three/addons/controls/OrbitControls.js";' >"$folder/three/OrbitControls.js"
cd "$folder" || exit 1
if [ ! -d node_modules/typescript ] || [ ! -d node_modules/@types/three ]; then
    echo '{"private": true}' >package.json
    if ! npm install --silent --no-audit --no-fund typescript@5.9.3 @types/three@0.180.0; then
        echo "lint-page: TypeScript could not be fetched; the types in src/view/page were not checked"
        exit 0
    fi
fi
node_modules/.bin/tsc -p jsconfig.json
