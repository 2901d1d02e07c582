"""Run the command line with `python -m jointstiff`."""

from jointstiff.service.cli.entry import main

if __name__ == "__main__":
    main()
