"""Tools of all other rooms: errors, arguments, checksums, pages and bars."""
