"""A page in the browser that shows a scene, its images and their truth while they are rendered (extra `live`)."""
