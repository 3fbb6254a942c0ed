"""The whole way: photos -> cameras and points -> Gaussians -> scores -> files."""
