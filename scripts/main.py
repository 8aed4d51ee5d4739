"""Entry point of the console script `slcp`: runs the commands of `slcp_warp.scripts.app`."""

import sys

CLI_PACKAGES = {"typer", "rich", "matplotlib", "PIL"}  # import names of the packages of the extra `cli`


def main() -> None:
    """Run the command line; where a package of the extra `cli` is missing, say what installs it."""
    try:
        from slcp_warp.scripts.app import app

        app()
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in CLI_PACKAGES:
            raise
        sys.exit(f"slcp: the command line needs the package '{package}': pip install 'slcp-warp[cli]'")


if __name__ == "__main__":
    main()
