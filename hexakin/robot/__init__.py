"""The robot: its model, its YAML file with all checks, and its URDF."""
