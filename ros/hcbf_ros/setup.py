"""The package of ROS: hcbf-gym itself is installed by pip, see docs/ros.md."""

from glob import glob

from setuptools import setup

NAME = "hcbf_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", glob("config/*.yaml")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="The hcbf-gym authors",
    maintainer_email="maintainers@users.noreply.invalid",
    description="A lifecycle node in the place of Nav2's collision monitor",
    license="MIT",
    entry_points={"console_scripts": [f"hcbf_filter = {NAME}.filter:main"]},
)
