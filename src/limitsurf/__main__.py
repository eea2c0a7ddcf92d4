"""The program ``limitsurf``, also as ``python -m limitsurf``, which Ctrl-C ends quietly."""


def main() -> None:
    """Run the command line on the arguments of the process."""
    try:
        from limitsurf.shell.cli.commands import main as program
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    program()


if __name__ == "__main__":
    main()
