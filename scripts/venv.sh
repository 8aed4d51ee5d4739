# Shared by the scripts here (sourced, not run): a virtual environment, and the project as a wheel.
# shellcheck shell=bash

# make_venv DIR: create the environment DIR where it does not work yet, with $PYTHON (default python3).
make_venv() {
  local dir=$1 python=${PYTHON:-python3}
  if "$dir/bin/python" -c 'import pip' 2>/dev/null; then return; fi
  if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
    echo "error: Python 3.11 or newer is needed; '$python' is not. Name another one with PYTHON=..." >&2
    return 1
  fi
  "$python" -m venv --clear "$dir"
}

# build_wheel PYTHON DIR: build the wheel of this tree into DIR and print its path. Other arguments go to pip.
build_wheel() {
  local python=$1 dir=$2
  shift 2
  rm -rf build/lib build/bdist.*  # setuptools would put what was deleted since the last build into the wheel
  "$python" -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir "$dir" "$@" . >&2
  echo "$dir"/slcp_warp-*.whl
}
