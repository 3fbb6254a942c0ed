"""What the add-on asks of the engine besides jobs: each question is a process that ends within seconds.

inspection   which effects the photos show; the point spread in a photo of a point of light
estimate     how long a run would take, and what it would reach
exact        the engine's own picture through the scene's camera
"""
