#!/usr/bin/env bash
# Build the documentation into out/docs (open index.html), in an environment of its own; warnings are errors.
#
#   bash scripts/docs.sh [arguments of sphinx-build]
#
# PYTHON       the interpreter to make the environment with (python3)
# SLCP_VENV    the folder of the environment (.venv-docs)
# SLCP_TORCH   the requirement that installs PyTorch, for the page of slcp_warp.torch, which is left out without
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
source scripts/venv.sh

venv=${SLCP_VENV:-.venv-docs}
export PYTHONSAFEPATH=1  # never import the bare folders kernels/ and ddp/ from here

make_venv "$venv"
wheels=$(mktemp -d)
trap 'rm -rf "$wheels"' EXIT
echo "Installing into $venv ..."
wheel=$(build_wheel "$venv/bin/python" "$wheels")
pip=("$venv/bin/python" -m pip install --quiet --disable-pip-version-check)
if [ -n "${SLCP_TORCH:-}" ]; then "${pip[@]}" "$SLCP_TORCH"; fi
"${pip[@]}" "$wheel[cli,docs]"
"${pip[@]}" --no-deps --force-reinstall "$wheel"  # the version alone does not tell that the code changed

rm -rf docs/reference/api out/docs  # pages of what is no longer there
"$venv/bin/sphinx-build" --fail-on-warning --keep-going --quiet -d out/doctrees docs out/docs "$@"
echo "Documentation: $PWD/out/docs/index.html"
