# The demo, driven while the image is built, and its recording in a browser:
#     docker build --tag agrobot-mj .
#     docker run --rm --init --publish 127.0.0.1:9090:9090 --publish 127.0.0.1:9876:9876 agrobot-mj
# Any other command, with its results in the folder at hand:
#     docker run --rm --user "$(id -u)" --env HOME=/tmp --volume "$PWD:/out" agrobot-mj agrobot-mj run circle --out /out/circle
FROM python:3.13-slim
RUN apt-get update \
    && apt-get install --yes --no-install-recommends make \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --create-home tractor \
    && install --directory --owner=tractor /opt/agrobot_mj
USER tractor
WORKDIR /opt/agrobot_mj
COPY --chown=tractor . .
# Kernels that the demo compiles serve every user of the image.
ENV PATH=/opt/agrobot_mj/.venv/bin:$PATH XDG_CACHE_HOME=/opt/agrobot_mj/.cache PIP_NO_CACHE_DIR=1
RUN make demo && chmod -R a+rwX .cache
EXPOSE 9090 9876
CMD ["sh", "-c", "echo 'Open http://127.0.0.1:9090?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A9876%2Fproxy' && exec rerun --web-viewer --bind 0.0.0.0 --port 9876 --web-viewer-port 9090 runs/demo/mujoco-pd_t2fnn-s1/run.rrd"]
