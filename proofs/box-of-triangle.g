# The column of a triangle's corner in the picture, in f32: asm/tracers/bounds.asm. It is
# X/Z focal/step + (half_width/step - 1/2), and the box begins at that plus `low`, which is
# 1 - (width + height) / 2^20.
#
# In a picture of 65535 by 65535 pixels, whose margin is 131070 / 2^20 = 0.125 pixels, the error is at
# most `error` for every corner that is projected beside the picture by at most its width. TP is
# focal/step, P the projected column, counted from the picture's middle. What is further outside is
# clamped to the picture's border. Negative X is the same by symmetry.
@r = float<ieee_32, ne>;
tp = r(TP); middle = r(COLUMN); low = r(LOW);
over = r(tp / Z); along = r(over * X);
column = r(along + middle); first = r(column + low);
P = TP / Z * X;
exact = P + COLUMN + LOW;
{ TP in [1b-20, 1b40] /\ Z in [1b-60, 1b40] /\ X in [1b-30, 1b40] /\ P in [1b-40, 65535]
  /\ TP / Z in [1b-60, 1b60] /\ COLUMN in [0, 65535] /\ LOW in [0.5, 1.5]
  -> |first - exact| <= $error }
along -> P * (1 + (along - P) / P) { P <> 0 };
first - exact -> (first - (column + low)) + (column - (along + middle)) + (along - P)
               + (middle - COLUMN) + (low - LOW);
along - P -> P * ((along - P) / P) { P <> 0 };
