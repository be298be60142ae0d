"""The `fleet` command. Modules of commands import what they need inside of their functions: `--help` must be quick."""
