pyblast: project.toml: can't be read (No such file or directory)
