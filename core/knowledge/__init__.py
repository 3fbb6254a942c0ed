"""What a twin knows and what it guesses: Fisher information through the blur, and the view to take next."""
