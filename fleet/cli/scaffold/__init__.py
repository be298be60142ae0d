"""The files of a new application, for `fleet init`."""
