"""The paper's specification model: a beta-VAE of the image with a classifier of (z_image, z_theta)."""
