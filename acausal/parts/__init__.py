"""What the author of a part reads: poses, inertias, joints, constraints, contacts, forces."""
