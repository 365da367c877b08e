"""What pyblast is measured against: the ladder, and an independent program."""
