#!/usr/bin/env bash
# Run the tests against the installed package, in an environment of its own (.venv-test).
#
#   bash scripts/test.sh [--fast] [pytest arguments]      --fast leaves out the tests marked slow
#
# PYTHON        the interpreter to make the environment with (python3)
# SLCP_TORCH    the requirement that installs PyTorch; empty: do without it. On Linux the registry's own
#               PyTorch brings gigabytes of CUDA libraries: point pip at a CPU build, or leave it out
# SLCP_VENV     the folder of the environment (.venv-test)
# SLCP_WORKERS  processes to spread the test files over with pytest-xdist (2); 0: this one. Most of the time
#               goes into compiling kernels, which one process does on one core
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
source scripts/venv.sh

torch=${SLCP_TORCH-torch==2.13.0}
workers=${SLCP_WORKERS:-2}
venv=${SLCP_VENV:-.venv-test}
export PYTHONSAFEPATH=1  # never import the bare folders kernels/ and ddp/ from here
# matrices of tests are small; threads that wait for work take time from the kernels' compiler
export OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
export OMP_WAIT_POLICY=${OMP_WAIT_POLICY:-PASSIVE}  # PyTorch's, which spin

arguments=()
for argument in "$@"; do
  if [ "$argument" = --fast ]; then arguments+=(-m "not slow"); else arguments+=("$argument"); fi
done

make_venv "$venv"
python=$venv/bin/python
pip=("$python" -m pip install --quiet --disable-pip-version-check)
wheels=$(mktemp -d)
trap 'rm -rf "$wheels"' EXIT

complete=true
optional() {  # WHAT REQUIREMENT: install it; where that fails, say so and go on (the next run tries again)
  if "${pip[@]}" "$2"; then return; fi
  complete=false
  printf '\n*** %s could not be installed (%s): its tests are left out ***\n\n' "$1" "$2" >&2
}

# Dependencies only when they changed; the project itself every time.
stamp="$venv/installed"
wanted="$(cksum < pyproject.toml) ${torch:-no torch}"
if [ "$(cat "$stamp" 2>/dev/null)" != "$wanted" ]; then
  rm -f "$stamp"
  echo "Installing the dependencies into $venv (the first time takes minutes) ..."
  "${pip[@]}" "setuptools>=77,<85" wheel
  wheel=$(build_wheel "$python" "$wheels" --no-build-isolation)
  if [ -n "$torch" ]; then optional "PyTorch" "$torch"; fi  # before anything could ask for a larger build
  "${pip[@]}" "$wheel[cli,test]"
  optional "The extra 'bench'" "$wheel[bench]"
  optional "JAX" "$wheel[jax]"
  if $complete; then echo "$wanted" > "$stamp"; fi
else
  wheel=$(build_wheel "$python" "$wheels" --no-build-isolation)
fi
"${pip[@]}" --no-deps --force-reinstall "$wheel"

if [ "$workers" -gt 0 ]; then  # in order of names: files of few tests, which compile the longest, would come last
  arguments=(-n "$workers" --dist loadfile --no-loadscope-reorder ${arguments[@]+"${arguments[@]}"})
fi
"$venv/bin/pytest" ${arguments[@]+"${arguments[@]}"}
