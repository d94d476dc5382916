"""What compiled code needs: the decorator, its store, and the records that are lent to it."""
