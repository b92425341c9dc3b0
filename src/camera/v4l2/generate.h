/* What bindgen reads: the kernel's header, and its function-like macros as constants. */
#include <linux/videodev2.h>

const unsigned long REQUEST_QUERYCAP = VIDIOC_QUERYCAP;
const unsigned long REQUEST_ENUM_FMT = VIDIOC_ENUM_FMT;
const unsigned long REQUEST_ENUM_FRAMESIZES = VIDIOC_ENUM_FRAMESIZES;
const unsigned long REQUEST_ENUM_FRAMEINTERVALS = VIDIOC_ENUM_FRAMEINTERVALS;
const unsigned long REQUEST_G_FMT = VIDIOC_G_FMT;
const unsigned long REQUEST_S_FMT = VIDIOC_S_FMT;
const unsigned long REQUEST_G_PARM = VIDIOC_G_PARM;
const unsigned long REQUEST_S_PARM = VIDIOC_S_PARM;
const unsigned long REQUEST_REQBUFS = VIDIOC_REQBUFS;
const unsigned long REQUEST_QUERYBUF = VIDIOC_QUERYBUF;
const unsigned long REQUEST_QBUF = VIDIOC_QBUF;
const unsigned long REQUEST_DQBUF = VIDIOC_DQBUF;
const unsigned long REQUEST_STREAMON = VIDIOC_STREAMON;
const unsigned long REQUEST_STREAMOFF = VIDIOC_STREAMOFF;
const unsigned long REQUEST_QUERY_EXT_CTRL = VIDIOC_QUERY_EXT_CTRL;
const unsigned long REQUEST_QUERYMENU = VIDIOC_QUERYMENU;
const unsigned long REQUEST_G_EXT_CTRLS = VIDIOC_G_EXT_CTRLS;
const unsigned long REQUEST_S_EXT_CTRLS = VIDIOC_S_EXT_CTRLS;

const unsigned int FOURCC_GREY = V4L2_PIX_FMT_GREY;
const unsigned int FOURCC_Y10 = V4L2_PIX_FMT_Y10;
const unsigned int FOURCC_Y12 = V4L2_PIX_FMT_Y12;
const unsigned int FOURCC_Y16 = V4L2_PIX_FMT_Y16;
const unsigned int FOURCC_YUYV = V4L2_PIX_FMT_YUYV;
const unsigned int FOURCC_UYVY = V4L2_PIX_FMT_UYVY;
const unsigned int FOURCC_NV12 = V4L2_PIX_FMT_NV12;
const unsigned int FOURCC_MJPG = V4L2_PIX_FMT_MJPEG;
const unsigned int FOURCC_JPEG = V4L2_PIX_FMT_JPEG;
