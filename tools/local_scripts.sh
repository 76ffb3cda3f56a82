#!/bin/sh
# What pages would fetch from the net when they are looked at, beside the site's own files: Mermaid, which draws state
# diagrams, the worker behind the search of a site that is opened as files, and a typeface for formulas. Without npm or
# the net the site is built all the same, and browsers do with what they have or can fetch.
set -eu
folder=$1

fetch() { # package, version, file in it, name here
    [ -e "$folder/$4" ] && return
    if made=$(cd "$folder" && npm pack --silent "$1@$2" 2> /dev/null); then
        tar -xzf "$folder/$made" -O "package/$3" > "$folder/$4"
        rm "$folder/$made"
    else
        echo "$1 could not be fetched: pages may need the net when they are looked at" >&2
    fi
}

mkdir -p "$folder"
fetch mermaid 11.17.2 dist/mermaid.min.js mermaid.min.js
fetch iframe-worker 1.0.4 shim/index.js iframe-worker.js
fetch @fontsource/stix-two-math 5.3.0 files/stix-two-math-latin-400-normal.woff2 math.woff2
