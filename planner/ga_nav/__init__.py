"""GA-Nav (Guan et al. 2022): six groups of ground by how one drives on them, seen in a colour image."""
