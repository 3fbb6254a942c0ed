"""What the photos determine about a twin and what they leave open: Fisher information through the blur, next views."""
