"""A thousand fleets on a thousand machines that are not there: what the operator is held against, and with."""
