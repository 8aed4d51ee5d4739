#!/usr/bin/env bash
# `slcp gpu-check` of this checkout on a machine where it is not installed and nothing can be fetched: any Python
# 3.11 or newer with warp-lang, numpy, typer and rich (PYTHON=..., default python3). Arguments are the command's.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
mkdir "$tree/slcp_warp"
ln -s "$root"/slcp_warp/* "$root"/{kernels,ddp,scripts} "$tree/slcp_warp/"
PYTHONPATH=$tree${PYTHONPATH:+:$PYTHONPATH} "${PYTHON:-python3}" -P -m slcp_warp.scripts.main gpu-check "$@"
