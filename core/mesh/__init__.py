"""A surface of a twin: depths from its cameras fused to a mesh with colours and standard deviations."""
