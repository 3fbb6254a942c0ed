"""What drives the render of a photo, and its gradients."""
