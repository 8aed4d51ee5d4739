#!/usr/bin/env bash
# From a fresh clone to a robustness report: installs the project into .venv and runs `slcp quickstart`.
#
#   bash scripts/quickstart.sh [arguments of slcp quickstart]
#
# PYTHON   the interpreter to make the environment with (python3)
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
source scripts/venv.sh

out=out/quickstart
export PYTHONSAFEPATH=1  # never import the bare folders kernels/ and ddp/ from here

make_venv .venv
wheels=$(mktemp -d)
trap 'rm -rf "$wheels"' EXIT
echo "Installing into .venv ..."
wheel=$(build_wheel .venv/bin/python "$wheels")
pip=(.venv/bin/python -m pip install --quiet --disable-pip-version-check)
"${pip[@]}" "$wheel[cli]"
"${pip[@]}" --no-deps --force-reinstall "$wheel"  # the version alone does not tell that the code changed

.venv/bin/slcp quickstart --out "$out" "$@"

echo
echo "Results:       $PWD/$out"
echo "Command line:  $PWD/.venv/bin/slcp --help"
