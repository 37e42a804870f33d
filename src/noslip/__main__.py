"""``python -m noslip`` is the command ``noslip``."""

from noslip.cli import main

if __name__ == "__main__":
    main()
