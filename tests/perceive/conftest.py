"""What tests with pictures need."""

from extras import need

need("cv2")
