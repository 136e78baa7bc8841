"""The page in the browser: look at footage, track it, watch, correct and export. Needs the extra
`studio`."""
