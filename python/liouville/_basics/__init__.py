"""What every other room uses: errors, arguments, checksums, pages and bars."""
