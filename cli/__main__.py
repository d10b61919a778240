"""`python -m retarget.cli`: the same as the command `retarget`."""

from retarget.cli.main import main

main()
