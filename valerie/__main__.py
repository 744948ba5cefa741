"""`python -m valerie`: the ``valerie`` command."""

from valerie.cli import main

if __name__ == "__main__":
    main()
