"""Run the command ``zwidth`` by ``python -m zwidth``."""

from zwidth.cli import main

if __name__ == "__main__":
    main()
