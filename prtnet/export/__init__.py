"""From a net spec to code that others run. Never imports torch or prtnet.models."""
