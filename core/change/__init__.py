"""What has changed between two twins of one object, separated from the medium and the light."""
