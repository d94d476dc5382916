"""From the matrices of a plant to the numbers of its controllers, which never see the plant."""
