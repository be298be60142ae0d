"""What a run has left in storage, as pictures, tables and one HTML page."""
