"""Long runs built on everything else: certificates, the paper reproduced, tuning, playground."""
