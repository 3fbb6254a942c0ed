"""Which effects the photos show, by cheap evidence, before anything is trained."""
