"""Energy and time: profiles of aircraft and edge machines, and what a flight costs by them."""
