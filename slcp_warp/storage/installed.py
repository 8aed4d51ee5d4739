"""The package's folder as it is installed, with kernels and planning in it, or as it lies in the sources."""

from importlib.util import find_spec


def require_installed(package: str, folder: str) -> None:
    """Say what is wrong where `package` is imported from the sources' `folder`, beside kernels/ and ddp/.

    Raises:
        ImportError: it is.
    """
    if find_spec(f"{package}.kernels") is None:
        raise ImportError(
            f"{package} was found in {folder}, a folder of its sources, which Python looks into before what "
            "is installed: start Python with -P, or in another folder (and `pip install .` first)"
        )
