"""What each knob costs in time and brings in accuracy, measured on a set whose truth is known: `measure_tradeoff`."""
