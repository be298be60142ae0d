"""The operator as a process: which fleet is looked at when, by which replica, and how it says that it is well."""
