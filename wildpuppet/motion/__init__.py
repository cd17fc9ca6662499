"""The puppet's own motion, without pictures: poses between poses, and poses carried to another puppet."""
