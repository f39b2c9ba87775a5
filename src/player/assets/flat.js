// flat
