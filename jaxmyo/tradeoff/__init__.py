"""The trade of speed for accuracy, measured: what an error of an output costs in seconds and memory, dial by dial."""
