"""What `apf track` keeps and says of its takes."""
