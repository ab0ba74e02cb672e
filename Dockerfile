# ADRL with what training needs. Written where there is no container engine: it was not built.
#
#     docker build -t adrl .
#     docker run --rm -v "$PWD:/work" adrl evaluate --policy default --map map.yaml
#     docker run --rm -v "$PWD:/work" --network host adrl view       # the page is on the loopback of the machine
FROM python:3.11-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends g++ && rm -rf /var/lib/apt/lists/*
WORKDIR /src
COPY . .
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.11-slim-bookworm
COPY constraints.txt /tmp/
COPY --from=build /wheels /tmp/wheels
RUN pip install --no-cache-dir -c /tmp/constraints.txt "$(echo /tmp/wheels/adrl-*.whl)[train]" && rm -r /tmp/wheels
RUN useradd --create-home adrl
USER adrl
WORKDIR /work
ENTRYPOINT ["adrl"]
CMD ["--help"]
