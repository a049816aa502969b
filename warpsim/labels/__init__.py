"""Labels: boxes, masks and tables of the targets in rendered images, and the files that networks are trained on."""
