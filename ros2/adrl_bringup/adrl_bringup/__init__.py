"""Launch files of ADRL's nodes. The nodes themselves are the command adrl, which pip installs."""
