"""Surface meshes in files, by the library that reads them, or own readers where none does."""
