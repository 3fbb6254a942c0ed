"""What a run will take, and what it can reach in a given time: probe, records of past runs, plans."""
